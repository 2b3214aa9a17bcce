"""The paper's experiment: its strings, targets, methods and seeds as experiments in the lab."""
