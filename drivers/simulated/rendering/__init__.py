"""The forward model: relief, materials and boards to what a sensor gets; it shares no code with the analysis."""
