"""Starting shapes and ready items: folds, cut patterns, presets, meshes."""
