"""Training of the learned methods: trainer, losses, crops, and a task file for each method.

`tasks.TASKS` finds the tasks by name; `data.dataset` provides the data.
"""
