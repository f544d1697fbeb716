"""How long a test waits for a program that should end by itself."""

# s; guards against a deadlock only.  No test asserts how fast anything is, as machines are shared:
# run times are what `./gossamer bench` measures.
HANG_TIMEOUT = 1200.0
