"""The studio in which Mary's recording was made, and can be made again; see README.md. The service uses none of it."""
