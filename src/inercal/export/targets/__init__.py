"""The targets, a module each; the registry `inercal.export.TARGETS` names them."""
