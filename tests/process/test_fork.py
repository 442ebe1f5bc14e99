"""A process that has stepped may be forked, spawned, and used in worker processes of torch."""

import os
from pathlib import Path

import pytest

from apart import STEP, run_apart

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")

FORKED = """
import os, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of forks beside threads
def forked(check, seconds=60):
    child = os.fork()
    if not child:
        import signal, traceback
        signal.alarm(seconds)  # a child that hangs ends by it
        try:
            check()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    assert status == 0, f"the child ended with status {status}"
"""


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_a_forked_child_goes_on_with_the_history_of_its_parent(executor: str, tmp_path: Path) -> None:
    """And leaves its recording alone."""
    recording = tmp_path / "recording"
    run_apart(f"""{STEP}{FORKED}
one, other = upscaler(executor="{executor}", record={str(recording)!r}), upscaler(executor="{executor}")
for u in (one, other):
    u.step(noise(0))
expected = other.step(noise(1))
def check():
    assert np.array_equal(one.step(noise(1)), expected)
    one.reset()
    fresh = upscaler("taau", executor="{executor}")  # loads in the child
    fresh.step(noise(0))
forked(check)
assert np.array_equal(one.step(noise(1)), expected)
""")
    assert len(list((recording / "calls").iterdir())) == 2


def test_a_child_forked_while_another_thread_steps_does_not_hang() -> None:
    run_apart(f"""{STEP}{FORKED}
import threading
from supersampler import Model
model = Model.load("taau", threads=2)
stop = threading.Event()
def steps():
    u = Upscaler(model, display_size=(64, 36), validate="off")
    while not stop.is_set():
        u.step(noise(0))
thread = threading.Thread(target=steps)
thread.start()
one = Upscaler(model, display_size=(64, 36), validate="off")
expected = one.step(noise(0))
for _ in range(20):
    forked(lambda: np.testing.assert_array_equal(one.step(noise(0)), expected), 20)
stop.set()
thread.join()
""")


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_a_forked_child_ends(executor: str) -> None:
    """The child frees the model, although it has none of the model's threads."""
    run_apart(f"""{STEP}
import os, signal, sys, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of forks beside threads
one = upscaler(executor="{executor}")
one.step(noise(0))
child = os.fork()
if not child:
    signal.alarm(60)  # a child that hangs ends by it
    sys.exit(0)
assert os.waitpid(child, 0)[1] == 0
one.step(noise(1))
""")


def test_a_forked_child_does_not_keep_a_folder_locked(tmp_path: Path) -> None:
    """Otherwise the next command could not write to a folder while a worker of a killed one still runs."""
    run_apart(f"""
import os, signal, time
from pathlib import Path
from supersampler.io.files import FolderLock
folder = Path({str(tmp_path)!r})
with FolderLock(folder):
    child = os.fork()
    if not child:
        (folder / "begun").touch()
        time.sleep(600)
    while not (folder / "begun").exists():
        time.sleep(0.01)
try:
    with FolderLock(folder):
        pass
finally:
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
""")


def test_workers_of_a_data_loader_step() -> None:
    run_apart(
        f"""{STEP}
import torch
from torch.utils.data import DataLoader, Dataset
one = upscaler("taau")
expected = one.step(noise(0))
class Images(Dataset):
    def __len__(self):
        return 6
    def __getitem__(self, index):
        return torch.from_numpy(one.step(noise(0)))
if __name__ == "__main__":
    import warnings
    warnings.simplefilter("ignore")
    loader = DataLoader(Images(), batch_size=2, num_workers=2, multiprocessing_context="fork", timeout=60)
    for batch in loader:
        for image in batch:
            assert np.array_equal(image.numpy(), expected)
"""
    )


def test_a_spawned_process_steps(tmp_path: str) -> None:
    run_apart(f"""{STEP}
import multiprocessing
from spawned_step import image_of
one = upscaler("taau")
one.step(noise(0))
with multiprocessing.get_context("spawn").Pool(1) as pool:
    image = pool.apply(image_of, (1,))
assert np.array_equal(image, upscaler("taau").step(noise(1)))
""")
