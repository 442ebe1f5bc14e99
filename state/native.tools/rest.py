exec(open('/tmp/par.py').read().split('if __name__')[0])
from dataclasses import replace
def scene(i, render, jitter, kind):
    h,w=render[1],render[0]
    yy,xx=np.mgrid[0:h,0:w].astype(np.float32)
    x=xx+jitter[0]; y=yy+jitter[1]
    c=np.stack([0.5+0.4*np.sin(x/3)*np.cos(y/4),0.5+0.4*np.sin(x/2.3+y/5),0.3+0.3*np.cos((x+y)/1.7)],2).astype(np.float32)
    if kind=="lamp" and i>60: c*=0.6
    m=np.zeros((h,w,2),np.float32)
    if kind=="part" : 
        k=(xx-w/2)**2+(yy-h/2)**2<(min(w,h)/5)**2
        c[k]*=np.float32(0.5+0.4*np.sin(i)); m[k]=(1.5,0.7)
    if kind=="start" and i>75: m+=0.5
    if kind=="nan" and i%7==0: c[2:4,3:5]=np.nan
    d=np.full((h,w),0.02,np.float32); d[h//3:h//2,w//3:w//2]=0.05
    return Frame(color=c,depth=d,motion=m,jitter=jitter,exposure=1.0,reset=False)
from supersampler.conventions.jitter import halton_jitter
def run(method, render, display, kind, frames=90, other="cpu", adds=1.0, skipcheck=True, threads=1):
    mb=model_bytes(Model.load(method,executor='cpu',threads=1).info)
    ex=NativeExecutor(lib,mb,threads); ref=Model.load(method,executor=other,threads=1)._executor
    mk=lambda e:[e.zeros(display,render),e.zeros(display,render)]
    h,k,r=mk(ex),mk(ex),mk(ref)
    img=lambda: np.zeros((display[1],display[0],3),np.float32)
    worst=[]; conv=[]
    for i in range(frames):
        f=scene(i,render,halton_jitter(i,display[0]/render[0]),kind)
        a,a2,b=img(),img(),img()
        oa=ex.step(f,display,h[0],h[1],a,("converged",),adds_samples=adds,skip=True)
        ex.step(f,display,k[0],k[1],a2,(),adds_samples=adds,skip=False)
        ob=ref.step(f,display,r[0],r[1],b,("converged",),adds_samples=adds,skip=True)
        for q in (h,k,r): q.reverse()
        if not (a==a2).all(): print("SKIP DIFFERS",i,np.abs(a-a2).max(), (a!=a2).sum()); break
        t=lambda x: x/(1+x.max(2,keepdims=True))
        d=np.abs(t(a)-t(b)); worst.append((d.max(),d.mean(),i))
        conv.append((oa.outputs["converged"].mean(),ob.outputs["converged"].mean()))
    m=max(worst); print(method,render,display,kind,"adds",adds,"worst max %.1e mean %.1e at %d"%m,"last max %.1e mean %.1e"%worst[-1][:2],"converged native/ref",[tuple(np.round(conv[j],2)) for j in (40,64,70,len(conv)-1) if j<len(conv)])
if __name__=="__main__":
    for m in sys.argv[2].split(","):
        for kind in ("static","lamp","part","start","nan"):
            run(m,(64,36),(128,72),kind, 86)
        run(m,(37,22),(81,47),"part",100)
        run(m,(64,36),(128,72),"static",60,adds=2.0)
