"""Files of Yade."""
