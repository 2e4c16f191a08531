"""Pictures, plots and films of runs. What is drawn here knows nothing of studies, sweeps and reports."""
