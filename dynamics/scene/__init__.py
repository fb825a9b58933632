"""The scene file: what is flown and how; materials, and which effects a scene calls for."""
