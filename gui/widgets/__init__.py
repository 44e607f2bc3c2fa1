"""Parts that every tab is made of: texts, colours, plots, jobs, commands."""
