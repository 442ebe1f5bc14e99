import sys, time
from pathlib import Path
import numpy as np
W='/work/wt/native'
sys.path[:0]=[W+'/sdk',W+'/model',W+'/bench',W+'/export',W+'/tests']
from supersampler.backends.cpu.native import *
from supersampler import Frame, Model
from noise import noise
lib=NativeLibrary(Path(sys.argv[1]))
import torch
torch.set_num_threads(1)
def compare(method, sizes, frames, other="onnx", isa="", bad=False, threads=1, reactive=False):
    render, display = sizes
    ex=NativeExecutor(lib, model_bytes(Model.load(method,executor='cpu',threads=1).info) if other!='x' and method not in ('bilinear','bicubic') else method, threads, isa)
    ref=Model.load(method, executor=other, threads=1)._executor
    rng=np.random.default_rng(3)
    h=[ex.zeros(display,render),ex.zeros(display,render)]; r=[ref.zeros(display,render),ref.zeros(display,render)]
    res=[]
    for i in range(frames):
        f=noise(i, render)
        kw={}
        if bad and i%2==1:
            c=f.color.copy(); c[2:5]=np.nan; c[6]=np.inf; c[7]=-1; c[8]=1e6; c[1,1]=np.nan
            m=f.motion.copy()*20; m[0]=np.nan; m[1]=np.inf
            d=f.depth.copy(); d[3]=np.nan; d[4]=-1; d[5]=np.inf
            kw=dict(color=c, motion=m, depth=d)
        if reactive: kw['reactive']=rng.random(render[::-1],np.float32)
        if kw:
            from dataclasses import replace
            f=replace(f,**kw)
        a=np.zeros((display[1],display[0],3),np.float32); b=a.copy()
        ex.step(f,display,h[0],h[1],a,("weight",),adds_samples=0.0,skip=True)
        ref.step(f,display,r[0],r[1],b,("weight",),adds_samples=0.0,skip=True)
        h.reverse(); r.reverse()
        e=float(abs(ref.tensor(r[0],"history.exposure")[0])) if 'exposure' in h[0].tensors() else 1.0
        t=lambda x: (x*e)/(1+(x*e).max(2,keepdims=True))
        d=np.abs(t(a)-t(b)); res.append((d.mean(),np.quantile(d,.999),d.max()))
        assert np.isfinite(a).all()
    print(method,other,ex.instructions,sizes,"bad" if bad else "", "reactive" if reactive else "", *("%.1e/%.1e/%.1e"%x for x in (res[0],res[-1],max(res,key=lambda v:v[2]))))
if __name__=="__main__":
    for m in sys.argv[2].split(","):
        others=sys.argv[3].split(",") if len(sys.argv)>3 else ["onnx"]
        for o in others:
            compare(m,((64,36),(128,72)),5,o)
            compare(m,((37,22),(81,47)),5,o)
            compare(m,((17,13),(17,13)),5,o)
            compare(m,((1,1),(1,1)),3,o)
            compare(m,((37,22),(81,47)),6,o,bad=True)
            compare(m,((37,22),(81,47)),6,o,reactive=True)
            for isa in ("avx2","portable"): compare(m,((37,22),(81,47)),6,o,bad=True,isa=isa)
