"""What `tools/bench` measures, a file for each kind of run."""
