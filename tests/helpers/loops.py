"""Who takes part in loops that threads share."""

import threading

from discsim.numerics.threads import parallel_for


def meet_in_a_loop(number):
    """A loop that ends once as many threads are in it at the same time; these."""
    met, found, entering = threading.Barrier(number), set(), threading.Lock()

    def meet(first, last):
        with entering:  # a thread that comes after so many has nobody left to wait for
            waits = threading.get_ident() not in found and len(found) < number
            if waits:
                found.add(threading.get_ident())
        if waits:
            met.wait(30.0)

    parallel_for(meet, 64, least=1)
    return found
