"""Many cases at once, on the cores of this machine or on a cluster: simulated, evaluated and summarised."""
