"""`taa`: temporal anti-aliasing with variance clipping (Salvi 2016)."""
