"""Radar video on the network: datagrams received into a recording, and a recording sent again.

The only part of the package that asks what time it is. Clocks are handed in, so that tests can turn them.
"""
