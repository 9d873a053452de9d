"""How well an avatar says sentences that its talker was recorded saying."""
