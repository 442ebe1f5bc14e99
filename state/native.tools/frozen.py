import sys
exec(open('/tmp/bench.py').read().split('if __name__')[0])
w,h=render
yy,xx=np.mgrid[0:h,0:w].astype(np.float32)
from supersampler.conventions.jitter import halton_jitter
J=[halton_jitter(i,2.0) for i in range(32)]
def fr(j):
    x=xx+j[0]; y=yy+j[1]
    c=np.stack([0.5+0.4*np.sin(x/9)*np.cos(y/11),0.5+0.4*np.sin(x/8.3+y/15),0.3+0.3*np.cos((x+y)/12.7)],2).astype(np.float32)
    return Frame(color=c,depth=np.full((h,w),0.02,np.float32),motion=np.zeros((h,w,2),np.float32),jitter=j,exposure=1.0,reset=False)
F4=[fr(j) for j in J]
def one(method):
    es={'n':NativeExecutor(lib, model_for(method), 1, isa),'p':Model.load(method, executor="cpu", threads=1)._executor}
    hs={k:[e.zeros(display,render),e.zeros(display,render)] for k,e in es.items()}
    img=np.zeros((display[1],display[0],3),np.float32)
    t={k:[] for k in es}
    for i in range(74):
        for k,e in es.items():
            hh=hs[k]; s=time.process_time()
            r=e.step(F4[i%32],display,hh[0],hh[1],img,("converged",),adds_samples=1.0,skip=True); hh.reverse()
            t[k].append(time.process_time()-s)
    a,b=np.array(t['n'])*1e3,np.array(t['p'])*1e3
    print(method,"converged",r.outputs["converged"].mean(),"native",np.round(a[[40,50,55,60,63,64,65,66,70,72,73]],1).tolist(),"numba",np.round(b[[40,50,55,60,63,64,65,66,70,72,73]],1).tolist())
for m in sys.argv[2].split(","): one(m)
