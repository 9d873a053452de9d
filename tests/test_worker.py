import io
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from app.worker import Worker, WorkerFailed, read, write

PROGRAM = """
import os, time
from app.worker import serve

def answer(question, payload):
    print("a library prints this")
    match question["task"]:
        case "double":
            return len(payload), payload * 2
        case "pid":
            return os.getpid(), b""
        case "sleep":
            time.sleep(60)
        case "end":
            os._exit(3)
    raise KeyError(question["task"])

serve(answer)
"""


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Worker]:
    (tmp_path / "worker_of_the_test.py").write_text(PROGRAM)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    worker = Worker("worker_of_the_test")
    yield worker
    worker.close()


def test_messages() -> None:
    pipe = io.BytesIO()
    write(pipe, {"text": "é"}, b"\0\xff")
    write(pipe, {})
    pipe.seek(0)
    assert read(pipe) == ({"text": "é"}, b"\0\xff")
    assert read(pipe) == ({}, b"")
    assert read(pipe) is None  # the end
    for cut in (b"\0\0", b"\0\0\0\x09{", b'\0\0\0\x0b{"bytes":3}ab'):
        assert read(io.BytesIO(cut)) is None


def test_one_process_answers_everything(worker: Worker) -> None:
    assert worker.pid is None
    big = bytes(range(256)) * 10_000
    assert worker.ask({"task": "double"}, big, seconds=30) == (len(big), big * 2)
    pid, _ = worker.ask({"task": "pid"}, seconds=30)
    assert worker.pid == pid
    with pytest.raises(WorkerFailed, match=r"KeyError: 'sing'"):
        worker.ask({"task": "sing"}, seconds=30)
    assert worker.ask({"task": "pid"}, seconds=30)[0] == pid


def test_it_is_replaced_when_it_ends(worker: Worker) -> None:
    with pytest.raises(WorkerFailed, match="exit code 3"):
        worker.ask({"task": "end"}, seconds=30)
    first, _ = worker.ask({"task": "pid"}, seconds=30)
    os.kill(first, signal.SIGKILL)
    os.waitid(os.P_PID, first, os.WEXITED | os.WNOWAIT)
    assert worker.pid is None
    assert worker.ask({"task": "pid"}, seconds=30)[0] != first


def test_it_is_ended_when_it_takes_too_long(worker: Worker) -> None:
    pid, _ = worker.ask({"task": "pid"}, seconds=30)
    with pytest.raises(WorkerFailed, match=r"longer than 0\.2 s"):
        worker.ask({"task": "sleep"}, seconds=0.2)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert worker.ask({"task": "pid"}, seconds=30)[0] != pid


def test_closing_ends_a_question_under_way(worker: Worker) -> None:
    worker.ask({"task": "pid"}, seconds=30)
    closer = threading.Timer(0.2, worker.close)
    closer.start()
    with pytest.raises(WorkerFailed):
        worker.ask({"task": "sleep"}, seconds=60)
    closer.join()
    worker.close()
    assert worker.pid is None
    assert worker.ask({"task": "double"}, b"a", seconds=30) == (1, b"aa")


def test_several_threads_get_their_own_answers(worker: Worker) -> None:
    def ask(number: int) -> tuple[int, bytes]:
        return worker.ask({"task": "double"}, b"x" * number, seconds=60)

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(ask, range(100))) == [(number, b"x" * number * 2) for number in range(100)]


def test_it_ends_with_the_one_who_asks(worker: Worker) -> None:
    pid, _ = worker.ask({"task": "pid"}, seconds=30)
    process = worker._process
    assert process is not None
    process._in.close()
    assert process._process.wait(30) == 0
    assert worker.pid is None
    assert worker.ask({"task": "pid"}, seconds=30)[0] != pid
