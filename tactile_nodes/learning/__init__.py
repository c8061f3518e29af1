"""How the shipped models came about: data sets, training, evaluation. The one place that may import torch."""
