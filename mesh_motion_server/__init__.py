"""The mesh-motion server: predicts mesh quality and corrects the motion before any node moves."""

__version__ = "0.1.0"
