"""Samples per second of PyTorch on the CPU for plain ReLU networks: one JSON line each on standard output.

Inference is the forward pass without gradients; training is forward, relative L2 loss, backward and Adam.
"""

import argparse
import itertools
import json
import time

import torch


def network(inputs, width, layers):
    """`layers` hidden layers of `width`, ReLU, three outputs: the paper's `width/layers` network."""
    sizes = [inputs] + [width] * layers
    parts = []
    for fan_in, fan_out in itertools.pairwise(sizes):
        parts += [torch.nn.Linear(fan_in, fan_out), torch.nn.ReLU(inplace=True)]
    return torch.nn.Sequential(*parts, torch.nn.Linear(width, 3))


def best_seconds(run, seconds=2.0):
    """The fastest of the calls of `run` that fit into `seconds`, after one warm-up."""
    run()
    best, end = float("inf"), time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - start)
    return best


def measure(inputs, width, layers, batch):
    """Samples per second of inference and training."""
    torch.manual_seed(0)
    model = network(inputs, width, layers)
    optimiser = torch.optim.Adam(model.parameters(), lr=1e-3)
    x, target = torch.rand(batch, inputs), torch.rand(batch, 3)

    def infer():
        with torch.inference_mode():
            model(x)

    def train():
        optimiser.zero_grad(set_to_none=True)
        y = model(x)
        ((y - target) ** 2 / (y.detach() ** 2 + 0.01)).mean().backward()
        optimiser.step()

    return {"inference": batch / best_seconds(infer), "training": batch / best_seconds(train)}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("networks", nargs="+", help="width/layers, e.g. 64/4")
    parser.add_argument("--inputs", type=int, default=43, help="network inputs")
    parser.add_argument("--batch", type=int, default=8192)
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    for name in args.networks:
        width, layers = map(int, name.split("/"))
        rates = measure(args.inputs, width, layers, args.batch)
        print(json.dumps({"peer": f"PyTorch {torch.__version__}", "network": name, "threads": args.threads, **rates}))


if __name__ == "__main__":
    main()
