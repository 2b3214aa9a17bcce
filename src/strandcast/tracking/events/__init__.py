"""Events and objects in a video besides the string: the target, the contact with it, an LED."""
