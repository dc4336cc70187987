"""Many runs: sweeps over settings and seeds, batches of recordings, and the table of what came of them.

Scale, by constants measured on one core of a shared two-core machine (CPU, not wall;
`python -m tests.bench.bench_sweep`, `python -m tests.bench.bench_batch`):

                                    per hour of recording
                                    simulated port      ship radar, Solent
    recording                       51 MB               65 MB        512 and 720 spokes a turn, 24 rpm
    CPU, preset radar, jipda        29 s                17 s         20 and 12 ms a turn; 3,100 and 6,700 points; of
                                                                     the port 11 s are scores against 42 outlines
    archive without the recording   46 MB               -
    archive with it                 -                   61 MB
    memory of a worker              255 MiB             144 MiB      the same for 200 and 1,000 turns

    a run besides its chain         9 ms CPU, 3 KiB of memory in the process that collects rows
    of these where rows are taken   0.6 ms from processes of this machine, 4 ms from a cluster
    the scheduler of a cluster      4 ms CPU a run
    a row                           8 KB on the disk, most of it the configuration
    the table, when all are done    0.25 ms CPU and 18 KiB of memory a run
    splitting, per hour             3 to 4 s CPU to find the turns, once and in one process; 3 to 5 s to join
    a seam, preset radar            327 turns of overlap, and 213, 277 and 198 (before: 520) for which the segment
                                    before is run on: 58 % more turns of two hours in four segments, so that two
                                    cores gain nothing; 39 % more of a long recording by segments of an hour, by the
                                    mean of these; at most, where none agree, all is run three times and the overlaps
                                    once
    a turn that is passed by        2 to 3 ms CPU, of what can't be read from the middle (pcapng, MCAP, gzip, several
                                    sensors): for each segment, and again where one is run on, all turns before it
    a memory that is handed on      155 KB, 10 ms CPU

Of these two hours joined, 102,445 of 102,477 rows of confirmed tracks are within 1 m of those of the run in one piece
and have their ids, 102,385 within 1 cm; all 105 tracks alive at the seams keep their ids.

Two workers against one, on a machine with nothing else to do: 1.90 times (40 runs of 1.9 s), 1.86 (1.4 s), 1.68
(1.2 s). A worker takes 1 s to start.

What a cluster would do. Runs know nothing of each other, segments no more than the memory of the one before, and rows
of some kilobytes are all that comes back, so N workers do N times the work until something else is full:

- The store of recordings: a worker reads 51 MB in 29 s (1.8 MB/s), and once more to know the digest. A 10 Gbit/s link
  feeds some 700 workers, a single disk of 200 MB/s some 110.
- The process that collects, and the scheduler: 4 ms a run. With runs of two seconds they are busy all the time at some
  500 workers, with runs over an hour of recording at 4,000 (17 s) to 7,000 (29 s).
- The table: of 100,000 runs 2 GB and half a minute in the process that collects.
- The end: the last piece is waited for. With n pieces for each worker at least n / (n + 1) of the time is work.

A hundred hours of such video (5 GB) with ten settings are 1,000 runs of 29 s: 8 hours on one core, 8 minutes on 64. One
recording of 24 hours in segments of one hour: 12 minutes on one core; on 24 workers 70 to 100 s to find the turns, 36 s
for a segment with its overlap, 5 to 30 s to run each on, all at once, and 70 to 120 s to join: three to five minutes.
Where two segments never tell the same, the next seam waits for that. These are estimates from the constants above; only
one and two workers have been measured.
"""
