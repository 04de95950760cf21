"""Many cases, on this machine or a cluster: simulated, judged, summarised. May import `run` and below."""
