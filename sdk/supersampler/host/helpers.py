"""Threads that help the caller's. A queue and locks: a stage of a step may be shorter than a future's way."""

import weakref
from _thread import allocate_lock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import Lock, Thread


@dataclass(eq=False)
class Order:
    """Something to do.

    Attributes:
        work: what.
        pending: held until it is done.
        error: that it raised.
    """

    work: Callable[[], None]
    pending: Lock = field(default_factory=allocate_lock)
    error: BaseException | None = None


class Helpers:
    """So many threads, until `close`, or until nobody knows them any more."""

    def __init__(self, count: int) -> None:
        self._orders = orders = SimpleQueue[Order | None]()
        for _ in range(count):
            Thread(target=_help, args=(orders,), name="supersampler", daemon=True).start()
        self.close = weakref.finalize(self, _stop, orders, count)

    def order(self, work: Callable[[], None]) -> Order:
        """Have one of them do it.

        Raises:
            RuntimeError: they were stopped.
        """
        if not self.close.alive:
            raise RuntimeError("helpers were stopped")
        order = Order(work)
        order.pending.acquire()
        self._orders.put(order)
        return order

    def wait(self, orders: Sequence[Order]) -> None:
        """Wait until all are done; raises what one of them raised."""
        for order in orders:
            order.pending.acquire()
        for order in orders:
            if order.error is not None:
                raise order.error


def _help(orders: "SimpleQueue[Order | None]") -> None:
    while (order := orders.get()) is not None:
        try:
            order.work()
        except BaseException as error:  # raised again where it was ordered
            order.error = error
        order.pending.release()
        del order  # what it holds may be freed before the next


def _stop(orders: "SimpleQueue[Order | None]", count: int) -> None:
    for _ in range(count):
        orders.put(None)
