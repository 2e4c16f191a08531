#include "massspring/kernels/padded_nodes.h"

#include <algorithm>
#include <memory>

namespace testbed::massspring {

Double4* columns(Eigen::Matrix4Xd& room, Eigen::Index n) {
  constexpr std::size_t kRegister = 64;  // bytes
  room.resize(4, n + 2);
  void* begin = room.data();
  std::size_t size = room.size() * sizeof(double);
  return static_cast<Double4*>(std::align(kRegister, size - kRegister, begin, size));
}

const Double4* pad(const Eigen::Matrix3Xd& in) {
  thread_local Eigen::Matrix4Xd kept;  // so that a step allocates nothing
  Double4* const padded = columns(kept, in.cols());
  for_each_chunk(in.cols(), [&](Eigen::Index begin, Eigen::Index end) {
    for (Eigen::Index i = begin; i < end; ++i) padded[i] = Double4{in(0, i), in(1, i), in(2, i), 0};
  });
  return padded;
}

Double4* zero_columns(Eigen::Index n) {
  thread_local Eigen::Matrix4Xd kept;
  Double4* const zeros = columns(kept, n);
  for_each_chunk(
      n, [&](Eigen::Index begin, Eigen::Index end) { std::fill(zeros + begin, zeros + end, Double4{}); });
  return zeros;
}

}  // namespace testbed::massspring
