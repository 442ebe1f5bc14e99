import sys
exec(open('/tmp/bench.py').read().split('if __name__')[0])
def one(method, adds=1.0):
    fs=frames(0.0)
    es={'n':NativeExecutor(lib, model_for(method), 1, isa),'p':Model.load(method, executor="cpu", threads=1)._executor}
    hs={k:[e.zeros(display,render),e.zeros(display,render)] for k,e in es.items()}
    img=np.zeros((display[1],display[0],3),np.float32)
    t={k:[] for k in es}
    for i in range(26):
        for k,e in es.items():
            h=hs[k]; s=time.process_time()
            e.step(fs[i%4],display,h[0],h[1],img,(),adds_samples=adds,skip=True); h.reverse()
            t[k].append(time.process_time()-s)
    a,b=np.array(t['n'])*1e3,np.array(t['p'])*1e3
    print(method,"native",np.round(a[[2,5,6,8,9,10,11,12,14,18,22,25]],1),"numba",np.round(b[[2,5,6,8,9,10,11,12,14,18,22,25]],1))
for m in sys.argv[2].split(","): one(m)
