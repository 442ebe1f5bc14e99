"""The public test shots; scenes and the renderer are in `supersampler_model.data`."""
