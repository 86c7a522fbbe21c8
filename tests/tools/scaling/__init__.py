"""Time and memory over the number of grains, against the usual tools and the machine's limit."""
