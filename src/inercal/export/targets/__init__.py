"""The export targets, one module for each; the registry is `inercal.export.TARGETS`."""
