"""Files of MercuryDPM."""
