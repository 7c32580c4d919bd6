"""Traffic: demand, SUMO in its own process, actor catalogue and meshes, Motion."""
