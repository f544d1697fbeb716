"""Time limit for programs that a test starts and that should end by themselves."""

# s; guards against a deadlock only.  No test asserts how fast anything is, as machines are shared:
# run times are what `./gossamer bench` measures.
HANG_TIMEOUT = 1200.0
