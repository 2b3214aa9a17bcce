"""experiment.yaml as typed, frozen sections: the arguments of the algorithms, each default once."""
