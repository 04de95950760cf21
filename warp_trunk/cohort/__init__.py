"""Many cases at once, on the cores of this machine or on a cluster: simulated, judged and told as one."""
