"""multidrop that waits for its broker 2 s at most, and connects again within one: `python impatient.py ARGUMENT...`.

Where a broker is killed and cut off often, most of a test's time would be the 10 s that an answer
may take, and pauses that grow to half a minute.
"""

from __future__ import annotations

from multidrop.gateway.mqtt import broker, part

if __name__ == "__main__":
    from multidrop import cli

    broker.TIMEOUT, part.LONGEST_PAUSE = 2.0, 1.0
    cli.main()
