"""`gbuffer` and related methods: supersampling with display-size G-buffers (Wang et al. 2025)."""
