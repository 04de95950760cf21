"""The planning page: sliders in a browser move a plan, and the back follows. May import `run` and below."""
