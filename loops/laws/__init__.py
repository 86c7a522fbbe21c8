"""Contact laws derived from `FrictionalLaw`: linear, cohesive, Hertz, rolling."""
