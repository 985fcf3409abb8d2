"""Work in other processes: jobs, workers, pools, and what they share."""
