import sys
sys.path[:0]=['/work/wt/native/sdk']
from supersampler import Model
from supersampler.backends.cpu.native import model_bytes
for m in ("classifier","classifier-small"):
    open(f"/tmp/{m}.model","wb").write(model_bytes(Model.load(m,executor="onnx",threads=1).info))
