"""Operating points with the direction of motion."""

from st_codegen.campaign.conditions import Conditions


def test_only_directions_that_some_rows_have_are_asked_about():
    at = Conditions.of([1.0, -1.0, 1.0, -1.0], 900.0, 400.0, 30.0)
    assert [rows.tolist() for rows in at.by_direction()] == [[False, True, False, True], [True, False, True, False]]
    assert [rows.tolist() for rows in at.by_direction(at.sign > 0)] == [[True, False, True, False]]
    assert at.by_direction(at.speed_rpm > 1000.0) == []
