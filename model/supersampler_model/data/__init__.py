"""The data that everything learns from: what is drawn, and the renderer that draws it with exact truth."""
