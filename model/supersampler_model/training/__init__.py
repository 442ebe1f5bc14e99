"""Training of the methods that learn: trainer, losses, crops, and one task file for each method.

`tasks.TASKS` finds the tasks by name; data comes from `data.dataset`.
"""
