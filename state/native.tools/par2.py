exec(open('/tmp/par.py').read().split('if __name__')[0])
for m in sys.argv[2].split(","):
    for o in sys.argv[3].split(","):
        for bad in (False,True):
            compare(m,((64,36),(128,72)),5,o,bad=bad)
            compare(m,((37,22),(81,47)),6,o,bad=bad)
        compare(m,((17,13),(17,13)),4,o); compare(m,((1,1),(1,1)),3,o)
        compare(m,((37,22),(81,47)),6,o,reactive=True)
        for isa in ("avx2","portable"): compare(m,((37,22),(81,47)),6,o,bad=True,isa=isa)
