"""MJCF models, their meshes, and `make_meshes`, which writes the meshes; see README.md in this folder."""
