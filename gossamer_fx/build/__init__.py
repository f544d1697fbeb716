"""Starting shapes and ready items: folds, cut patterns, presets, assemblies, meshes."""
