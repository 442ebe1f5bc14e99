"""Training sets on disk: rendered sequences with references and labels, resumable, memory-mapped.

`dataset.json` lists the sequences. Crops are cut by `training.crops`.
"""

from supersampler_model.data.dataset.rendering import RenderPlan, plan_sequences, render_sequence
from supersampler_model.data.dataset.storage import (
    Dataset,
    Description,
    SequenceEntry,
    TrainingFrame,
    create_dataset,
    open_dataset,
    read_training_frame,
    write_training_frame,
)

__all__ = [
    "Dataset",
    "Description",
    "RenderPlan",
    "SequenceEntry",
    "TrainingFrame",
    "create_dataset",
    "open_dataset",
    "plan_sequences",
    "read_training_frame",
    "render_sequence",
    "write_training_frame",
]
