"""Speed of the engine: fast and reference on one thread, beside the encoder, and threads against processes."""

from __future__ import annotations

import multiprocessing
import statistics
import time
from collections.abc import Callable

import numpy as np

from app.config import StreamSettings
from app.engine.avatar import Avatar, load_avatar
from app.engine.frame import empty
from app.engine.pool import FrameJob, OrderedPool
from app.stream.encoder import VideoEncoder
from bench.recorded import FOLDER, recording
from bench.report import Report

REPEATS = 5
BATCH = 400


def run() -> list[Report]:
    """Frames a second of engine and encoder; threads against processes."""
    return [_speed(), _threads()]


def seconds(work: Callable[[], None], repeats: int = REPEATS) -> float:
    """Median duration of some work after one unmeasured run."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def _speed() -> Report:
    report = Report("engine", "Composited 512x512 frames on one thread, loop and head motion included")
    avatar, literal = load_avatar(FOLDER), load_avatar(FOLDER, "reference")
    source = recording()
    spoken = avatar.trajectory(source.phones, len(source.luma))
    picture = empty(512, 512)

    def draw(who: Avatar, count: int) -> None:
        for number in range(count):
            who.render(spoken[number], number, picture)

    fast = seconds(lambda: draw(avatar, BATCH)) / BATCH
    reference = seconds(lambda: draw(literal, 24), 3) / 24
    pictures = []
    for number in range(100):
        avatar.render(spoken[number], number, picture)
        pictures.append(picture.copy())

    def encode() -> None:
        settings = StreamSettings()
        encoder = VideoEncoder(512, 512, 25, preset=settings.preset, crf=settings.crf, max_kbps=settings.max_kbps)
        for number, drawn in enumerate(pictures):
            encoder.encode(drawn, number)

    encoder = seconds(encode) / len(pictures)
    report.add("fast", 1 / fast, "frames/s", ">= 400", f"{fast * 1e3:.2f} ms a frame")
    report.add(
        "reference",
        reference * 1e3,
        "ms a frame",
        "<= 84",
        "Fu 2011: 84 ms on one thread (51.8 s for 615 frames, table 4.1)",
    )
    report.add("fast against reference", reference / fast, "times", ">= 20")
    report.add("encoder alone (x264, live settings)", encoder * 1e3, "ms a frame", note="same pictures, same run")
    report.add("engine against encoder", fast / encoder, "of the encoder's time")
    return report


FRAMES = 500


def _lanes(streams: int, workers: int) -> float:
    """Frames a second of `streams` lanes, synthesised and encoded by one pool."""
    avatar = load_avatar(FOLDER)
    source = recording()
    spoken = avatar.trajectory(source.phones, len(source.luma))
    pool = OrderedPool(workers)

    def draw(job: FrameJob) -> np.ndarray:
        picture = empty(512, 512)
        avatar.render(spoken[job.index % len(spoken)], job.index, picture)
        return picture

    def once() -> float:
        settings = StreamSettings()
        encoders = [
            VideoEncoder(512, 512, 25, preset=settings.preset, crf=settings.crf, max_kbps=settings.max_kbps)
            for _ in range(streams)
        ]
        lanes = [
            pool.open(draw, lambda job, picture, encoder=encoder: encoder.encode(picture, job.index))
            for encoder in encoders
        ]
        start = time.perf_counter()
        for lane in lanes:
            lane.submit(FrameJob(number, 0.0) for number in range(FRAMES))
            lane.finish()
        for lane in lanes:
            lane.wait()
        return streams * FRAMES / (time.perf_counter() - start)

    once()
    rate = statistics.median(once() for _ in range(3))
    pool.close()
    return rate


def _process(barrier: multiprocessing.synchronize.Barrier, results: multiprocessing.Queue) -> None:
    barrier.wait()
    results.put(_lanes(1, 1))


def _processes() -> float:
    context = multiprocessing.get_context("spawn")
    barrier, results = context.Barrier(2), context.Queue()
    workers = [context.Process(target=_process, args=(barrier, results)) for _ in range(2)]
    for worker in workers:
        worker.start()
    rate = sum(results.get() for _ in workers)
    for worker in workers:
        worker.join()
    return rate


def _threads() -> Report:
    report = Report("pool", "The ordered-encoding pool: synthesis and encoding, two streams")
    processes = _processes()
    threads = _lanes(2, 2)
    report.add("two processes, one thread each", processes, "frames/s", note="baseline")
    report.add("one process, two workers", threads, "frames/s")
    report.add("workers against processes", 100 * threads / processes, "%", ">= 90")
    report.add("one worker", _lanes(1, 1), "frames/s")
    return report
