"""Training of the learned methods: trainer, losses, crops, and a task file for each method.

`tasks.start_task` finds the task of a method; `data.dataset` provides the data.
"""
