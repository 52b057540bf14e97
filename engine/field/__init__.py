"""The field: HexPlane, Z_kin, and the branches that decode it."""

from degense.engine.field.model import ROUTINGS, FieldConfig, Routing, SceneModel, State

__all__ = ["ROUTINGS", "FieldConfig", "Routing", "SceneModel", "State"]
