"""The study of paths behind `grainloops diamond` and `grainloops polygon`."""
