"""Numbers only: model, trajectories, renderers, avatar packs and their training. No HTTP, no asyncio."""
