// The four models of the paper's Table 1: its node counts, 500 internal nodes, its multiplicities.
#pragma once

#include "massspring/calibrations/calibrate.h"
#include "meshing/network/network.h"
#include "meshing/surface/shapes.h"

namespace testbed::massspring {

struct Table1 {
  const char* shape;
  int n_surface, multiplicity;
  double explicit_fps, implicit_fps;  // as published
};
inline const Table1 kModels[]{{"ball", 162, 5, 33.25, 1.42},
                              {"torus", 924, 5, 12.51, 0.50},
                              {"handle", 932, 3, 16.62, 0.66},
                              {"head", 3897, 3, 5.14, 0.23}};

inline MassSpringModel make_model(const Table1& row, double E) {
  const SurfaceMesh surface = make_shape(row.shape, row.n_surface);
  SampleOptions sampling;
  sampling.k = 500;
  sampling.phi = sampling.psi = 0.02;
  Material material;
  material.E = E;
  return calibrate(link_pcp(surface, sample_interior(surface, sampling), {row.multiplicity}), material,
                   find_calibration("uniform"));
}

}  // namespace testbed::massspring
