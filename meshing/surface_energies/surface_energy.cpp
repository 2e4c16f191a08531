#include "meshing/surface_energies/surface_energy.h"

#include <algorithm>
#include <cmath>

namespace testbed::meshing {

bool is_invariant(const SurfaceEnergies& energies) {
  return std::all_of(energies.begin(), energies.end(),
                     [](const auto& energy) { return energy->is_invariant(); });
}

double rounding(const SurfaceEnergies& energies, const Eigen::Matrix3Xd& x) {
  double sum = 0;
  for (const auto& energy : energies) sum += energy->rounding(x);
  return sum;
}

bool is_stiff(const SurfaceEnergies& energies) {
  return std::any_of(energies.begin(), energies.end(), [](const auto& energy) { return energy->is_stiff(); });
}

NewtonReport minimise_constrained(const SurfaceEnergies& energies,
                                  const std::function<NewtonReport()>& minimise,
                                  const std::function<Eigen::Matrix3Xd()>& positions) {
  constexpr int kMost = 30;
  NewtonReport report = minimise();
  const auto is_renewed = [&] {
    bool is_any = false;
    for (const auto& energy : energies) is_any |= energy->renew(positions());
    return is_any;
  };
  for (int n = 0; report.status == Status::Ok && is_renewed(); ++n) {
    const int iterations = report.iterations;
    if (n == kMost) {
      report.status = Status::NotConverged;
      report.reason = "no pressure holds the volume";
      return report;
    }
    report = minimise();
    report.iterations += iterations;
  }
  return report;
}

bool passes_through(const SurfaceEnergies& energies, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) {
  return std::any_of(energies.begin(), energies.end(),
                     [&](const auto& energy) { return energy->passes_through(x, y); });
}

std::vector<std::pair<std::string, double>> contact_columns(const SurfaceEnergies& energies,
                                                            const Eigen::Matrix3Xd& x,
                                                            const Eigen::Matrix3d& frame) {
  std::vector<std::pair<std::string, double>> columns;
  for (const auto& energy : energies) {
    const std::vector<Contact> contacts = energy->contacts(x);
    for (size_t k = 0; k < contacts.size(); ++k) {
      const std::string name = "obstacle_" + std::to_string(k);
      const Eigen::Vector3d force = frame * contacts[k].force;
      for (int c = 0; c < 3; ++c) columns.emplace_back(name + "_force_" + "xyz"[c], force(c));
      columns.emplace_back(name + "_area", contacts[k].area);
    }
    if (const auto pressure = energy->holding_pressure()) columns.emplace_back("volume_pressure", *pressure);
  }
  return columns;
}

bool SurfaceHessian::empty() const {
  return diagonal.empty() && pairs.empty() && blocks.empty() && roots.empty() && curvatures.empty();
}

void SurfaceHessian::clear() {
  *this = {};
}

void SurfaceHessian::scale(double factor) {
  for (Eigen::Matrix3d& block : diagonal) block *= factor;
  for (NearPair& pair : pairs) pair.stiffness *= factor;
  for (SymmetricBlock& b : blocks) b.block *= factor;
  for (Eigen::Matrix3Xd& g : roots) g *= std::sqrt(factor);
  for (VolumeCurvature& c : curvatures) c.factor *= factor;
}

void SurfaceHessian::add_volume(double factor, const Faces& faces, const Eigen::Matrix3Xd& x) {
  if (faces.F.cols() == 0) return;
  if (!faces.is_curved()) {
    curvatures.push_back({factor, &faces.F, x.leftCols(faces.F.maxCoeff() + 1)});
    return;
  }
  for (Eigen::Index t = 0; t < faces.F.cols(); ++t) {
    const Eigen::VectorXi face = faces.nodes(t);
    const EnclosedVolume v = enclosed_volume(x(Eigen::all, face));
    for (int a = 0; a < face.size(); ++a)
      for (int b = a; b < face.size(); ++b)
        blocks.push_back({face(a), face(b), factor * v.hessian.block<3, 3>(3 * a, 3 * b)});
  }
}

void SurfaceHessian::add_diagonal(std::vector<Eigen::Matrix3d>& sum) const {
  for (size_t i = 0; i < diagonal.size(); ++i) sum[i] += diagonal[i];
  for (const NearPair& pair : pairs)
    for (int a = 0; a < 4; ++a)
      sum[pair.node[a]] +=
          pair.stiffness * pair.weight[a] * pair.weight[a] * pair.normal * pair.normal.transpose();
  for (const SymmetricBlock& b : blocks)
    if (b.i == b.j) sum[b.i] += b.block;
}

void SurfaceHessian::add_within(BlockMatrix& A) const {
  for (size_t i = 0; i < diagonal.size(); ++i) A.block[A.diagonal[i]] += diagonal[i];
  for (const SymmetricBlock& b : blocks) {
    const int upper = A.find_any(b.i, b.j);
    if (upper < 0) continue;
    A.block[upper] += b.block;
    if (b.i != b.j) A.block[A.find(b.j, b.i)] += b.block.transpose();
  }
}

void SurfaceHessian::add_product(const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) const {
  add_sparse_product(p, y);
  for (const Eigen::Matrix3Xd& g : roots)
    y.leftCols(g.cols()) += g.cwiseProduct(p.leftCols(g.cols())).sum() * g;
  for (const VolumeCurvature& c : curvatures) add_volume_curvature(c.factor, *c.F, c.x, p, y);
}

std::vector<PaddedField> SurfaceHessian::single_roots() const {
  std::vector<PaddedField> single(roots.size());
  for (size_t k = 0; k < roots.size(); ++k) pad(roots[k], 1, single[k]);
  return single;
}

void SurfaceHessian::add_product(const std::vector<PaddedField>& single, const PaddedField& p,
                                 PaddedField& y) const {
  add_sparse_product(p, y);
  for (const PaddedField& g : single) add_scaled(static_cast<float>(dot(g, p)), g, y);
  if (curvatures.empty()) return;
  Eigen::Index n = 0;
  for (const VolumeCurvature& c : curvatures) n = std::max(n, c.x.cols());
  const Eigen::Matrix3Xd q = p.topLeftCorner(3, n).cast<double>();
  Eigen::Matrix3Xd z = Eigen::Matrix3Xd::Zero(3, n);
  for (const VolumeCurvature& c : curvatures) add_volume_curvature(c.factor, *c.F, c.x, q, z);
  y.topLeftCorner(3, n) += z.cast<float>();
}

SurfaceMemories memories_of(const SurfaceEnergies& energies) {
  SurfaceMemories memories;
  for (const auto& energy : energies)
    if (const auto memory = energy->memory()) memories.push_back(memory);
  return memories;
}

void remember(const SurfaceMemories& memories, const SurfaceEnergies& energies) {
  auto memory = memories.begin();
  for (const auto& energy : energies)
    if (memory != memories.end() && energy->memory()) energy->remember(*memory++);
}

}  // namespace testbed::meshing
