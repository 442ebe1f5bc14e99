"""Training sets on disk: rendered sequences with references and labels, resumable, memory-mapped.

`dataset.json` lists the sequences. Crops are cut by `training.crops`.
"""

from supersampler_model.data.dataset.description import (
    Dataset,
    Description,
    SequenceEntry,
    create_dataset,
    open_dataset,
)
from supersampler_model.data.dataset.frame_file import (
    TrainingFrame,
    read_training_frame,
    write_training_frame,
)
from supersampler_model.data.dataset.rendering import RenderPlan, plan_sequences, render_sequence

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
