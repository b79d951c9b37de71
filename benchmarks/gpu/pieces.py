"""The pieces of `python -m benchmarks.gpu`: compiled side by side in processes of their own, measured one at a time."""

import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial

from benchmarks.gpu import measure, tables

TIMED = ("rates", "ppo", "diagnosis")
"""Pieces that are measured one at a time."""

_shared = {}


def _share(lock, barrier, until):
    _shared.update(lock=lock, barrier=barrier, until=until)


def _run(piece, *names):
    """A piece in a process of its own, with what it shares with others; None where the time is over."""
    if time.time() > _shared["until"]:
        return None
    return piece(**{name: _shared[name] for name in names})


def pieces(arguments, count):
    """Name -> what measures it, in order; ``count``: how many GPUs there are."""
    seconds, found = arguments.seconds, {}
    for case in arguments.cases:
        found[f"work/{case}"] = partial(measure.work, case)
        found[f"episodes/{case}"] = partial(measure.episodes, case)
        found[f"rates/{case}/cpu"] = partial(measure.on_the_cpu, case, seconds)
    found["ppo/cpu"] = partial(measure.ppo_on_the_cpu, steps=arguments.ppo_steps)
    if arguments.diagnosis:
        found["diagnosis/cpu"] = partial(measure.diagnosis, "cpu")
    if count:
        for case in arguments.cases:
            for precision in tables.PRECISIONS:
                piece = partial(measure.on_the_device, case, precision, seconds, sizes=arguments.sizes)
                found[f"rates/{case}/{precision}"] = piece
        if arguments.diagnosis:
            found["diagnosis/cuda"] = partial(measure.diagnosis, "cuda")
    return found


def _tried(arguments, found):
    score = found["ppo/cpu"]["error"]
    return partial(measure.ppo_on_the_device, score=score, envs=arguments.ppo_envs, updates=arguments.ppo_updates)


def measured(arguments, found, save):
    """Fill in what is missing; returns the names of pieces that have failed."""
    context = multiprocessing.get_context("spawn")
    until, failed = time.time() + arguments.limit, []
    count = measure.devices()

    def pool(workers, parties=1):
        shared = context.Lock(), context.Barrier(parties), until
        return ProcessPoolExecutor(
            workers, context, initializer=_share, initargs=shared, max_tasks_per_child=1,
        )  # fmt: skip

    def take(name, future):
        try:
            result = future.result()
        except Exception as error:  # whatever a device or its compiler says: the other pieces go on
            failed.append(name)
            print(f"{name}: {type(error).__name__}: {str(error).strip()[-300:]}", file=sys.stderr)
            return
        if result is not None:
            found[name] = result
            save()
            print(f"{name}: {result}", flush=True)

    with pool(arguments.jobs) as workers:
        waiting = {
            workers.submit(_run, piece, *(["lock"] if name.split("/")[0] in TIMED else [])): name
            for name, piece in pieces(arguments, count).items()
            if name not in found
        }
        for future in as_completed(waiting):
            take(waiting[future], future)
    if count and "ppo/cpu" in found and "ppo/cuda" not in found:
        with pool(1) as workers:
            take("ppo/cuda", workers.submit(_run, _tried(arguments, found), "lock"))
    shards = arguments.shards or count
    if shards > 1 and "shards" not in found:
        with pool(shards, shards) as workers:
            made = [
                workers.submit(
                    _run, partial(measure.shard, k, seconds=arguments.seconds, size=arguments.sizes[-1]), "barrier"
                )
                for k in range(shards)
            ]
            take("shards", _All(made))
    return failed


class _All:
    """Several results as one."""

    def __init__(self, futures):
        self.futures = futures

    def result(self):
        found = [future.result() for future in self.futures]
        return None if None in found else found
