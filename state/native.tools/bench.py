"""bench.py LIB METHOD[,..] [rest]: interleaved native/numba steps at 1080p from 540p; ratio of medians, 1 and 2 threads."""
import sys, time, os
from pathlib import Path
import numpy as np
W='/work/wt/native'
sys.path[:0]=[W+'/sdk',W+'/model',W+'/bench',W+'/export',W+'/tests']
from supersampler.backends.cpu.native import *
from supersampler import Frame, Model
from supersampler.cli.demo import *
rng=np.random.default_rng(0)
render,display=(960,540),(1920,1080)
if os.environ.get('SIZE')=='4k': render,display=(1920,1080),(3840,2160)
def frames(moving):
    w,h=render
    yy,xx=np.mgrid[0:h,0:w].astype(np.float32)
    out=[]
    for i in range(4):
        s=3.3*i*moving
        c=np.stack([0.5+0.4*np.sin((xx+s)/7)*np.cos(yy/9),0.5+0.4*np.sin((xx+s)/3+yy/5),0.3+0.3*np.cos((xx+s+yy)/11)],2).astype(np.float32)+rng.random((h,w,3),np.float32)*0.05
        d=(0.01+0.02*((np.sin((xx+s)/60)+np.cos(yy/40))>0)).astype(np.float32)
        m=np.zeros((h,w,2),np.float32); m[...,0]=3.3*moving*(1+np.sin(yy/50)); m[...,1]=0.7*moving
        out.append(Frame(color=c,depth=d,motion=m,jitter=((0.25,0.25),(-0.25,0.1),(0.1,-0.25),(-0.1,0.4))[i],exposure=1.0,reset=False))
    return out
lib=NativeLibrary(Path(sys.argv[1]))
isa=os.environ.get('ISA','')
n=int(os.environ.get('N','25'))
def model_for(method):
    try:
        from supersampler.backends.cpu.native import model_bytes
        return model_bytes(Model.load(method,executor="cpu",threads=1).info)
    except ImportError: return method
def run(method, threads, moving=1.0, adds=0.0):
    fs=frames(moving)
    ex=NativeExecutor(lib, model_for(method), threads, isa)
    ref=Model.load(method, executor="cpu", threads=threads)._executor
    hs={k:[e.zeros(display,render),e.zeros(display,render)] for k,e in (('n',ex),('p',ref))}
    img=np.zeros((display[1],display[0],3),np.float32)
    t={'n':[],'p':[]}
    for i in range(n):
        for k,e in (('n',ex),('p',ref)):
            h=hs[k]; s=time.perf_counter()
            e.step(fs[i%4],display,h[0],h[1],img,(),adds_samples=adds,skip=True); h.reverse()
            t[k].append(time.perf_counter()-s)
    a,b=(np.array(t[k][4:]) for k in 'np')
    print(f"{method} threads={threads} moving={moving} adds={adds} native {1e3*np.median(a):.1f} ms numba {1e3*np.median(b):.1f} ms ratio {np.median(a)/np.median(b):.3f} mean {a.mean()/b.mean():.3f} min {1e3*a.min():.1f}/{1e3*b.min():.1f}")
if __name__=="__main__":
    for m in sys.argv[2].split(","):
        for threads in (1,2): run(m,threads)
