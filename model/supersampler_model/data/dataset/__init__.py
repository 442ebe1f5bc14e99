"""Training sets on disk: rendered sequences with references and labels, resumable, memory-mapped."""

from supersampler_model.data.dataset.storage import open_dataset, read_training_frame

__all__ = ["open_dataset", "read_training_frame"]
