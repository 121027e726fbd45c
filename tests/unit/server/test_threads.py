"""Work in threads and the tasks that ask for it."""

import asyncio
import threading

from server.threads import in_thread


def test_what_a_thread_returns_is_returned() -> None:
    assert asyncio.run(in_thread(divmod, 7, 3)) == (2, 1)


def test_a_cancelled_task_ends_after_its_thread() -> None:
    started, may_end, ended = threading.Event(), threading.Event(), threading.Event()

    def work() -> None:
        started.set()
        assert may_end.wait(10.0)
        ended.set()

    async def cancelled() -> bool:
        task = asyncio.create_task(in_thread(work))
        while not started.is_set():
            await asyncio.sleep(0.001)
        task.cancel()
        await asyncio.sleep(0.01)
        waited = not task.done()
        may_end.set()
        await asyncio.gather(task, return_exceptions=True)
        return waited and ended.is_set() and task.cancelled()

    assert asyncio.run(cancelled())
