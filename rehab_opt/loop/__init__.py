"""Controllers run in time: a loop with absolute deadlines, records that other processes read, logs, devices."""
