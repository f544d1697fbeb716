"""Mesh generators whose groups demos, tutorials and tests call by name.

An installed package has them as `gossamer_fx.meshes`.  In a clone `gossamer_fx/build/meshes` is a
symbolic link to this folder.

A generator distributes its mesh to the ranks of `comm`; all of them call it.
"""
