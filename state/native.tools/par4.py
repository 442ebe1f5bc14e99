exec(open('/tmp/par.py').read().split('if __name__')[0])
from supersampler_bench.specs import with_default_gbuffers
from supersampler.methods.gbuffer_fast.spec import GBUFFERS_READ
from dataclasses import replace
import math
def go(render,display,frames,isa="",threads=1,adds=0.0,still=False):
    m="gbuffer-fast"
    ex=NativeExecutor(lib,model_bytes(Model.load(m,executor='cpu',threads=1).info),threads,isa); ref=Model.load(m,executor="cpu",threads=1)._executor
    mk=lambda e:[e.zeros(display,render),e.zeros(display,render)]
    h,r=mk(ex),mk(ref); res=[]
    rng=np.random.default_rng(1)
    for i in range(frames):
        f=with_default_gbuffers(noise(0 if still else i,render),GBUFFERS_READ,display)
        if i==0: print({k:v.shape for k,v in f.gbuffer.items()},{k:v.shape for k,v in f.gbuffer_display.items()}) if isa=="" else None
        gb={k:(rng.random(v.shape,np.float32) if 'normal' not in k else (rng.random(v.shape,np.float32)-0.5)*1.5).astype(np.float32) for k,v in f.gbuffer.items()}
        gd={k:(rng.random(v.shape,np.float32)*(0.1 if k=='depth' else 1) if 'normal' not in k else (rng.random(v.shape,np.float32)-0.5)*1.5).astype(np.float32) for k,v in f.gbuffer_display.items()}
        f=replace(f,gbuffer=gb,gbuffer_display=gd)
        a=np.zeros((display[1],display[0],3),np.float32); b=a.copy()
        ex.step(f,display,h[0],h[1],a,(),adds_samples=adds,skip=True); ref.step(f,display,r[0],r[1],b,(),adds_samples=adds,skip=True); h.reverse(); r.reverse()
        d=np.abs(a/(1+a)-b/(1+b)); res.append((d.mean(),np.quantile(d,.999),d.max()))
    print(m,ex.instructions,render,display,*("%.1e/%.1e/%.1e"%x for x in res))
go((64,36),(128,72),4); go((37,22),(81,47),5); go((37,22),(81,47),4,"avx2"); go((37,22),(81,47),4,"portable"); go((37,22),(81,47),5,threads=3); go((1,1),(1,1),3)
