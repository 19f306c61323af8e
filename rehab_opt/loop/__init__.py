"""Real-time loop that runs a controller on a robot; records for other processes, logs, drivers of devices."""
