"""The picture and the map of the rooms are those of the imports."""

from tools.architecture import MAP, PICTURE, imports, layers, picture, with_map


def test_the_picture_is_drawn_from_the_imports_of_today():
    assert PICTURE.read_text(encoding="utf-8") == picture(), "run make architecture"


def test_the_map_in_contributing_is_that_of_today():
    page = MAP.read_text(encoding="utf-8")
    assert page == with_map(page), "run make architecture"


def test_rooms_import_lower_layers_alone():
    level = {name: k for k, layer in enumerate(layers()) for name in layer}
    drawn = imports()
    assert sum(map(len, drawn.values())) > len(level)
    assert all(level[one] > level[name] for name, ends in drawn.items() for one in ends)
