"""Whether the tests see faults: `python -m tests.mutation`."""
