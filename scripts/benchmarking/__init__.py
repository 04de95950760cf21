"""The parts of scripts/benchmark.py. All but `prepare` run where only numpy and warp are installed."""
