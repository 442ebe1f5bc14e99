"""cpu.py LIB METHOD..: single-thread process-CPU times, native against numba, interleaved."""
import sys
exec(open('/tmp/bench.py').read().split('if __name__')[0])
def one(method, moving=1.0, adds=0.0, only=False):
    fs=frames(moving)
    es={'n':NativeExecutor(lib, model_for(method), 1, isa)}
    if not only: es['p']=Model.load(method, executor="cpu", threads=1)._executor
    hs={k:[e.zeros(display,render),e.zeros(display,render)] for k,e in es.items()}
    img=np.zeros((display[1],display[0],3),np.float32)
    t={k:[] for k in es}
    for i in range(n):
        for k,e in es.items():
            h=hs[k]; s=time.process_time()
            e.step(fs[i%4],display,h[0],h[1],img,(),adds_samples=adds,skip=True); h.reverse()
            t[k].append(time.process_time()-s)
    a=np.array(t['n'][4:]); b=np.array(t.get('p',t['n'])[4:])
    print(f"{method} moving={moving} adds={adds} cpu native {1e3*np.median(a):.1f} numba {1e3*np.median(b):.1f} ratio {np.median(a)/np.median(b):.3f} min {1e3*a.min():.1f}/{1e3*b.min():.1f}")
if __name__=="__main__":
    for m in sys.argv[2].split(","): one(m, only=len(sys.argv)>3)
