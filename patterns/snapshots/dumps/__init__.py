"""Text dumps of LAMMPS and LIGGGHTS."""
