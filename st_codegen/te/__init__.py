"""All that knows of transmission error: the bundle, its blocks, their check and the latency of the loop."""
