"""How the shipped models were made: data sets, training, evaluation. Only this package may import torch."""
