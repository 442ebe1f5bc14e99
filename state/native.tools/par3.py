exec(open('/tmp/par.py').read().split('if __name__')[0])
for o in ("cpu",):
    compare("classifier-large",((64,36),(128,72)),5,o); compare("classifier-large",((41,24),(81,47)),5,o); compare("classifier-large",((41,24),(81,47)),5,o,bad=True)
    compare("classifier-large",((41,24),(81,47)),5,o,threads=3,reactive=True); compare("classifier-large",((1,1),(1,1)),3,o)
