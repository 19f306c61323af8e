"""Real-time loop of a controller: absolute deadlines, records for other processes, logs, devices."""
