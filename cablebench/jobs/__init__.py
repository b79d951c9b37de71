"""Independent pieces of work, on this machine or on a cluster: jobs go in, finished ones come out as they end.

    with open_backend("local", jobs=2) as backend:
        for done in backend.run(jobs, progress=lambda p: print(p.key, p.done, p.total, p.text)):
            print(done.job.key, done.value())

A job is a module-level function with picklable arguments. Its worker may be killed at any time (no memory, no power);
then it is run again, so it must be idempotent: what it keeps in its folders it goes on from. The caller alone writes
results, so nothing is lost or counted twice.
"""

from cablebench.jobs.driver import Backend, open_backend
from cablebench.jobs.work import Context, Done, Job, JobError, Progress, Stopped

__all__ = ["Backend", "Context", "Done", "Job", "JobError", "Progress", "Stopped", "open_backend"]
