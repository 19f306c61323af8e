"""Problems in real time, as shown on the page of `rehab-opt live`."""
