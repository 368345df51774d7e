"""Proposals of a trained graph network: its definition in torch, its inputs, and its inference by ONNX Runtime."""
