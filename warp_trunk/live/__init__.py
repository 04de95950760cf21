"""The planning page: a plan is moved by sliders in a browser, and the back follows."""
