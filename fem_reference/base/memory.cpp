#include "fem_reference/base/memory.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "meshing/base/files.h"

namespace testbed::fem {
namespace {

constexpr double kGiB = 1024. * 1024 * 1024;

/// The number after `label` in a file, in `unit`; none: infinite.
double number_in(const char* file, const std::string& label, double unit) {
  if (std::filesystem::exists(file)) {
    std::istringstream text(meshing::read_file(file));
    for (std::string line; std::getline(text, line);)
      if (line.rfind(label, 0) == 0 && line != "max") return unit * std::stod(line.substr(label.size()));
  }
  return std::numeric_limits<double>::infinity();
}

}  // namespace

double memory_needed(double n_tetrahedra, int degree, Memory kind, const Processes& processes) {
  constexpr double kProgram = 0.25e9, kPerTetrahedron[] = {1500, 5900};  // multigrid; two levels
  constexpr double kOfShare[] = {3400, 6800},
                   kWhole = 600;  // of several processes; on the first, per tetrahedron
  const double matrix = kPerTetrahedron[degree - 1] * n_tetrahedra;
  if (processes.n > 1)
    return processes.n_here * (kProgram + kOfShare[degree - 1] * n_tetrahedra / processes.n) +
           kWhole * n_tetrahedra;
  if (kind == Memory::Iterations) return kProgram + matrix;
  constexpr double kDofs[] = {0.6, 4.4}, kFill[] = {280, 400};  // per tetrahedron; of nested dissection
  const double copies = kind == Memory::FactorAndCopy ? 1.5 : 1;
  return kProgram +
         std::max(matrix, copies * kFill[degree - 1] * std::pow(kDofs[degree - 1] * n_tetrahedra, 4. / 3));
}

double memory_available() {
  constexpr const char* kGroup = "/sys/fs/cgroup/";
  const std::string limit = std::string(kGroup) + "memory.max", used = std::string(kGroup) + "memory.current";
  const double of_group = number_in(limit.c_str(), "", 1);
  return std::min(number_in("/proc/meminfo", "MemAvailable:", 1024),
                  std::isfinite(of_group) ? of_group - number_in(used.c_str(), "", 1) : of_group);
}

void check_memory(std::int64_t n_tetrahedra, int refine, int degree, Memory kind, double available,
                  const Processes& processes) {
  const auto needed = [&](int r) {
    return memory_needed(static_cast<double>(n_tetrahedra) * std::pow(8, r), degree, kind, processes);
  };
  if (needed(refine) <= available) return;
  std::ostringstream what;
  what.precision(2);
  what << "reference.degree = " << degree << ", reference.refine = " << refine << ": "
       << static_cast<double>(n_tetrahedra) * std::pow(8, refine) << " tetrahedra need about "
       << needed(refine) / kGiB << " GiB, " << available / kGiB << " GiB are free; expected ";
  int fits = refine - 1;
  while (fits >= 0 && needed(fits) > available) --fits;
  if (fits >= 0) {
    what << "refine <= " << fits;
  } else {
    double low = 0, high = static_cast<double>(n_tetrahedra);
    for (int k = 0; k < 50; ++k) {
      const double middle = (low + high) / 2;
      (memory_needed(middle, degree, kind, processes) <= available ? low : high) = middle;
    }
    what << "at most " << low << " tetrahedra (a coarser surface, a larger reference.interior_size"
         << (degree == 2 ? ", degree 1)" : ")");
  }
  throw std::runtime_error(what.str());
}

}  // namespace testbed::fem
