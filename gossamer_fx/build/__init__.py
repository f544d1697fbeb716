"""Starting shapes and ready parts: folds, cut patterns, presets, assemblies, meshes."""
