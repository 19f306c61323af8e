"""Run a controller on a robot in real time, log the run, and exchange data with devices and other processes."""
