"""`gbuffer` and its relatives: supersampling with display-size G-buffers (Wang et al. 2025)."""
