"""Questions asked: snapshots, the paper, speed against error; figures and the command line."""
