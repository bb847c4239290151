"""MJCF models: data, and `make_meshes`, which wrote the meshes. See README.md in this folder."""
