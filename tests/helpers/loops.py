"""Who takes part in loops that threads share."""

import threading

from discsim.numerics.threads import share


def meet_in_a_loop(number):
    """A loop that ends once as many threads are in it at the same time; these."""
    met, found = threading.Barrier(number), set()

    def meet(first, last):
        if threading.get_ident() not in found:
            found.add(threading.get_ident())
            met.wait(30.0)

    share(meet, 64, least=1)
    return found
