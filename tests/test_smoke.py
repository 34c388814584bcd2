def test_imports():
    import inercal  # noqa: F401
